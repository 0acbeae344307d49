"""The geometry of a light-field camera, from white images and checkerboards."""
