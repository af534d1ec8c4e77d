"""Time laws: one file a law; each turns a joint path and limits into one Trajectory type."""
