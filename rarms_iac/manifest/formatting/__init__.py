"""The canonical form of a manifest's text: read with its comments, ordered, and written anew."""
