"""Tables and sidecars that the steps exchange: columns, units, ranges."""
