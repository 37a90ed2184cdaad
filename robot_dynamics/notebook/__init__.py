"""What notebooks show: tables, pictures and plots of robots and of results, as HTML that runs no script."""
