"""Scripts for separate environments, for peers whose packages conflict with ours; none is imported here."""
