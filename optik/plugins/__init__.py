"""Plug-ins: files given by a path, and entry points of installed packages.

A file contains code, so it is imported only if its path is given. Its module is a submodule of this package, named by the
file's absolute path, so that another process can unpickle its classes. A process runs one version of a file: a file that
has changed since its import is an error.
"""

import optik.plugins.files  # noqa: F401 - finds the modules of files, also where only a pickle asks for them
