"""The numbers of the tracker that are fitted to rendered clips."""
