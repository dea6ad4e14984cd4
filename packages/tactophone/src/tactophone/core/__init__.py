"""What every floor uses: values, errors, settings, processes."""
