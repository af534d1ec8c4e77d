"""Problem sets: one file a set; a set is targets, starts and what is known of them."""
