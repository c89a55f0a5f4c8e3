"""What each kind of mesh file says, carried over whole or refused by name and line; one module for each kind of file."""
