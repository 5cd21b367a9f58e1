"""How good it is: samples with known answers, and what to measure on them."""
