"""Results and figures to HTML and PDF."""
