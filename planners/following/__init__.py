"""From a Cartesian path to a joint path: one branch of configurations tracked and proved, with exact derivatives."""
