"""A search in one file: a probabilistic roadmap (Kavraki et al. 1996), random configurations joined by proved edges.

Try it: ``planners.find_path(robot, start, goal, scene=scene, search="examples/plugins/prm.py")``.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from planners.search import Search, SearchAttempt


class Roadmap(Search):
    """The shortest path of the graph of near neighbours; `find_path` shortens and checks it."""

    def __init__(self, max_samples=1000, *, neighbours=10):
        super().__init__(max_samples)
        self.neighbours = neighbours

    def search(self, space, start, goals, seed):
        """Return the shortest path from the start (n,) to one of the goals (k, n) [rad, m]."""
        lower, upper = space.find_range(np.array([start, *goals]))
        drawn = np.random.default_rng((*seed, 1)).uniform(lower, upper, (self.max_samples, len(start)))
        nodes = np.array([start, *goals, *filter(space.is_free, drawn)])
        near = KDTree(nodes).query(nodes, min(self.neighbours + 1, len(nodes)))[1][
            :, 1:
        ]  # the first is the node itself
        edges = [(i, j) for i, row in enumerate(near) for j in row if space.is_edge_free(nodes[i], nodes[j])]
        i, j = np.array(edges, dtype=int).reshape(-1, 2).T
        graph = csr_array((np.linalg.norm(nodes[i] - nodes[j], axis=1), (i, j)), shape=(len(nodes), len(nodes)))
        away, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
        way = [1 + int(away[1 : 1 + len(goals)].argmin())]
        if np.isinf(away[way[0]]):
            return SearchAttempt(None, self.max_samples)
        while way[-1] != 0:
            way.append(int(before[way[-1]]))
        return SearchAttempt(nodes[way[::-1]], self.max_samples)


METHOD = Roadmap
