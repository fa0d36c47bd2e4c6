"""The ground floor: errors, logs, files, tables, plug-ins and processes; it knows no other room."""
