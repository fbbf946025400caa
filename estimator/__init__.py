"""What the recording says about the motion: filter, evidence on what its model lacks, positions."""
