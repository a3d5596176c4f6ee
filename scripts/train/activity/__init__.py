"""The activity nets: training data, features, training, export."""
