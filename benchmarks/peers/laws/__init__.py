"""Time laws of other packages, one per file; their motions are certified in the same way as ours."""
