"""Design: which input tells what is wanted, seen through these sensors and inside these limits."""
