"""The command line: verbs that declare arguments, call the library and print."""
