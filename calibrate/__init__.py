"""The application: study files, batch jobs, reports and the command line."""
