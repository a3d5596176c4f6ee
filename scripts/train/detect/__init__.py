"""The vehicle detector: fine-tunes NanoDet-g for surveillance cameras."""
