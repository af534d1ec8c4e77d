"""Path following: from a Cartesian path to a joint path of one branch, with exact derivatives and proved deviation."""
