"""Links and drives: CAN, CiA 402, profiles, replay."""
