"""Kinematics, dynamics and inverse kinematics of serial arms."""

import gc
import sys
import threading

_collects = gc.isenabled()
_alone = threading.active_count() == 1 and not {"numba", "yaml"} & sys.modules.keys()
gc.disable()  # an import makes no garbage, and looking for it takes a sixth of the time
if _alone:
    sys.modules["yaml"] = None  # type: ignore[assignment] # Numba only reads settings with it, which `optik.compiled` ignores
try:
    import numba  # noqa: F401 -- without YAML

    if _alone:
        del sys.modules["yaml"]
    from optik import errors as errors
    from optik import ik as ik
    from optik.arm.inertia import Inertia, Payload
    from optik.arm.library import load
    from optik.arm.limits import JointLimits, VelocityByPosition
    from optik.arm.robot import DHRow, Robot
    from optik.arm.shapes import Shapes
    from optik.errors import OptikError
    from optik.ik import IKResult, IKStatus, Tolerance, solve_ik, solve_ik_batch
    from optik.ik.start import choose_start
    from optik.scene import Scene
    from optik.task import Task
finally:
    if not gc.get_freeze_count():
        gc.freeze()  # what was imported counts as old
        gc.unfreeze()
    if _collects:
        gc.enable()

__version__ = "0.1.0"

__all__ = [
    "DHRow",
    "IKResult",
    "IKStatus",
    "Inertia",
    "JointLimits",
    "OptikError",
    "Payload",
    "Robot",
    "Scene",
    "Shapes",
    "Task",
    "Tolerance",
    "VelocityByPosition",
    "choose_start",
    "load",
    "robots",
    "solve_ik",
    "solve_ik_batch",
]


def robots() -> tuple[str, ...]:
    """Return the names of the robots that come with optik or with installed packages."""
    from optik.registry import names

    return names("optik.robots")
