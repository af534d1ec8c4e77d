"""From a Cartesian path to joints: one branch tracked and proved, exact derivatives along s."""
