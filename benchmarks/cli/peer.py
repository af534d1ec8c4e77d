"""`optik bench peer`: separate environments for peers whose packages conflict with optik's."""

from __future__ import annotations

import os
import shutil
import subprocess
import venv
from typing import Annotated, Any

import typer

from benchmarks.cli.shared import err_console, out_console
from benchmarks.peers.ik import PEERS
from benchmarks.peers.ik.base import missing, version_of
from optik.errors import InvalidInput, OutputError
from optik.registry import load_method

LAST_WORDS = 400
"""Largest number of characters of pip's last line in an error."""


def bench_peer(
    name: Annotated[str, typer.Argument(help="Name of a peer, from `optik doctor`.")],
    install: Annotated[
        bool, typer.Option("--install", help="Create its environment and install its package there.")
    ] = False,
) -> None:
    """Show the version and settings of a peer, or why it cannot run; with --install, create its environment.

    Environments are folders in $OPTIK_PEERS, by default optik/peers in the user's data folder. To remove one, delete it.
    """
    kind: Any = load_method(PEERS, name, "peer")
    if install:
        if not hasattr(kind, "environment"):
            raise InvalidInput(
                "--install", name, f"a peer with a separate environment; for this one: pip install {kind.distribution}"
            )
        _install(kind)
    why = missing(kind)
    out_console.print(
        f"{name}: {why or f'{kind.distribution} {version_of(name)}'}", highlight=False, markup=False, soft_wrap=True
    )
    out_console.print(kind.settings, highlight=False, markup=False, soft_wrap=True)


def _install(kind: Any) -> None:
    """Create the environment of a peer, and remove it if this fails."""
    folder, python = kind.environment(), kind.python()
    outside = {k: v for k, v in os.environ.items() if k not in ("PIP_CONSTRAINT", "PYTHONPATH", "PYTHONHOME")}
    try:
        with err_console.status(f"installing {', '.join(kind.requirements)}"):
            venv.create(folder, with_pip=True, clear=True)
            pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *kind.requirements]
            subprocess.run(pip, check=True, capture_output=True, text=True, env=outside | {"PYTHONSAFEPATH": "1"})
    except subprocess.CalledProcessError as error:
        shutil.rmtree(folder, ignore_errors=True)
        said = (str(error.stderr).strip().splitlines() or ["pip failed"])[-1]
        raise OutputError(folder, said[:LAST_WORDS]) from None
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise OutputError(folder, error.strerror or str(error)) from None
