"""The paper's whole system: a laser that finds a spot, a main control that plans the motion to it, drives that execute it."""

from planners.cell.laser import PanTiltLaser, Plane, Sighting, SightStatus, Spot

__all__ = ["PanTiltLaser", "Plane", "SightStatus", "Sighting", "Spot"]
