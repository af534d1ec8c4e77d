"""Plug-ins: files given by a path, and the plug-ins in a suite's settings."""
