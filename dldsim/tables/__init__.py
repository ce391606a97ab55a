"""Every table's columns, units and meaning; reading and writing."""
