"""Mesh formats, a module each: `write(mesh, facts)` makes the bytes of a file, `read(content)` takes them apart."""
