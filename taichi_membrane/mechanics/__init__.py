"""What fabric, gas and loads do: forces, energies and tangents of one structure, on the device."""
