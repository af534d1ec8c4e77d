"""What only `closed_form` uses: outside closed forms, and from their candidates to branches."""
