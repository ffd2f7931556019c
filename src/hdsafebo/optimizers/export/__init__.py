"""What a method believes, as models of another library. Nothing of a method depends on it."""
