"""A user's own classes in a file of YAML: measurement and motion models, plants, parts."""
