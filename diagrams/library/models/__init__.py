"""The models of the packaged systems, as they are and as they are believed."""
