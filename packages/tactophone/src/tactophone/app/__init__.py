"""What users do, one function each: values in, results out."""
