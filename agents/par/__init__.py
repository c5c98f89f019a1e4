"""The par of every task: what is possible, between a bound that nothing beats and the best plan that is found."""
