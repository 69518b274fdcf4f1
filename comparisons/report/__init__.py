"""The report page, its tables, plots and pictures, from records alone."""
