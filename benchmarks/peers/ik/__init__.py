"""Outside IK methods: one file each, called as its users call it, judged by our forward kinematics."""
