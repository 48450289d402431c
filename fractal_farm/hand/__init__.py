"""What people do with designs: judge, breed, steer, tune and keep (DESIGN section 5, the pseudo-run `hand`)."""
