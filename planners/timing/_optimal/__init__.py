"""What only `optimal` uses: the programme along the path, its start, and the interior-point iteration."""
