"""Component code to machine code: traced on symbols, written as loops over environments, compiled by Numba, cached."""
