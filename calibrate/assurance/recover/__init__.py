"""The command `recover`: whether a fit's claims would survive a repetition."""
