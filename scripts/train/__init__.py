"""Training code of roadplane: cars and the atlas, rendered pictures, the keypoint net, the activity nets."""
