"""Cases with a known answer, the runs that reproduce them, and the report of how near they come."""
