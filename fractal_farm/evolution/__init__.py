"""Evolution as pure decisions: no Ray, no clock, no files, no global random state (NOTES, 'Evolution'; DESIGN section 4)."""
