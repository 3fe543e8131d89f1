"""Whether a calibration can be signed: what traces can tell, before it (`check`), and what a repetition gives, after it
(`recover`)."""
