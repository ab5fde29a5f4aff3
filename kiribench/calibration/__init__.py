"""Material laws fitted to tensile curves, with uncertainty and the range where they hold."""
