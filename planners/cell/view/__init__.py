"""A motion to look at: in one page that plays it, or in the browser while a simulated drive executes it."""
