"""Build hook: after `make kernels`, a wheel contains the kernels of its platform and Python."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the archive of this platform and Python; without one, the wheel stays pure."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the archive, and tag the wheel for this platform; an editable installation stays as it is."""
        name = runpy.run_path(str(Path(self.root, "optik", "compiled", "archive.py")))["file_name"]()
        file = Path(self.root, "optik", "compiled", "_kernels", name)
        if version != "editable" and file.exists():
            build_data["force_include"][str(file)] = f"optik/compiled/_kernels/{name}"
            build_data |= {"pure_python": False, "infer_tag": True}
