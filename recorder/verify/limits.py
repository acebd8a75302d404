"""How much is too much: beyond these shares a log is not to be trusted, and a rule fails."""

from __future__ import annotations

# Frames lost, by number or in pauses. They are not lost at random, but where the image was large,
# the network weak or the computer busy. Studies give the 95 % quantile of the errors: with more
# than a twentieth of the frames missing it could be any number.
LOST_PERCENT = 5.0

# Images that are corrupt or of another size. Less than may be lost: a lost frame gives no number,
# a damaged one may give a wrong one, and not every damaged one shows.
CORRUPT_PERCENT = 1.0

# Intervals between captures that are off by half of the usual one or more. It is a quarter if each
# frame is stamped anywhere within its own interval: then stamps say no more than frame numbers do.
# Also frames at the time of another.
IRREGULAR_PERCENT = 25.0

# From here on it is worth a warning.
IRREGULAR_NOTED_PERCENT = 1.0
