"""The vocabulary of all rooms: constants, channels, errors, records, file schemas, words, paths."""
