"""Evolution as pure decisions: no Ray, no clock, no files, no global random state (DESIGN section 4)."""
