"""Parts of scenario files that several questions share."""
