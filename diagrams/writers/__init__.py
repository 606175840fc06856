"""Files for other programs to read: each format a function from data to text."""
