"""A run as one page of HTML that opens from the disk: see docs/page.md."""
