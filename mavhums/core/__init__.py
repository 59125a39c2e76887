"""What every room may use: errors, quantities, compiled kernels, files that appear whole."""
