"""Light fields that an ordinary camera takes one view after the other, as an arm moves it."""
