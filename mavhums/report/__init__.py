"""The contracts: what mavhums says of a log, as typed, versioned objects."""
