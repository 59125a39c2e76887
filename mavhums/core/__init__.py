"""Shared basics: errors, quantities, compiled kernels, atomic files."""
