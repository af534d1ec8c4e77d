"""What a motion keeps: one file a judgement, each a proved bound, its place, and the active constraint."""
