"""Planning of runs: the noise of the data, the risk of each method, and the plan."""
