"""Linear programs that grow by columns: our own, and HiGHS where it is installed. Nothing exact rests on them."""
