"""What only `lm` uses: the packed arm, its starts, and the search in lanes."""
