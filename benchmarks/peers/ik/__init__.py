"""IK methods of other packages, one per file: called as their users call them, judged by our forward kinematics."""
