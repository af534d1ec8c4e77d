"""Search for collision-free joint paths, one module for each method; each edge of a path is proved."""

from planners.search._find import find_path
from planners.search.base import JointSpace, Search, SearchResult, SearchStatus

__all__ = ["JointSpace", "Search", "SearchResult", "SearchStatus", "find_path"]
