"""An elastic arm beyond its joints' own stiffness: links, base, coupling, friction, variation."""
