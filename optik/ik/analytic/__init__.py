"""Parts of `closed_form`: backends, roots and branches."""
