"""Outside ways to time a joint path: one file each, judged by the same certificate as our laws."""
