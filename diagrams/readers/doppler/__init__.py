"""Files about one satellite that is heard: two-line elements, received frequencies, where the station is."""
