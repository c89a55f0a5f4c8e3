"""How far the program can be pushed: extreme materials, meshes, states and loads, each swept until something gives."""
