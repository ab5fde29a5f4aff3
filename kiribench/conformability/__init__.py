"""How well a worn patch covers the skin, cell by cell, and why it does not."""
