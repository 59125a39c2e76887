"""The contracts: mavhums' results for a log, as typed, versioned objects."""
