"""A recorded run, read from its bag: figures of merit, acceptance, pictures, report."""
