"""Search for collision-free joint paths, one module for each method; each edge of a path is proved."""

from planners.search.base import JointSpace, Search, SearchAttempt, SearchResult, SearchStatus
from planners.search.find import find_path

__all__ = ["JointSpace", "Search", "SearchAttempt", "SearchResult", "SearchStatus", "find_path"]
