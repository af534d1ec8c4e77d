"""Plug-ins: files that a user names by a path, and entry points of installed packages; what a run records of both.

Running a file is running code: a file is imported only when it is asked for by its path. The module of a file is a
submodule of this package, named by the file's absolute path, so that its classes are found again when they are unpickled
in another process. One process runs one version of a file: a file that has changed since it was imported is refused.
"""

import optik.plugins.files  # noqa: F401 - finds the modules of files, also where only a pickle asks for them
