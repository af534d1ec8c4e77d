"""Parts of `optimal`: the programme along the path, its initial guess, and the interior-point iteration."""
