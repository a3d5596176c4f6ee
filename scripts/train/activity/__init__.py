"""Activities of vehicles: training data, features, the net, its export."""
