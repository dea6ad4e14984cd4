"""What users of the laboratory do: one function a verb."""
