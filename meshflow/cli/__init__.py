"""The command `meshflow`."""
