"""Between the card and the messages: scaling, watchdog, unloading."""
