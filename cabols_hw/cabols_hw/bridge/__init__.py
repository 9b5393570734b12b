# SPDX-License-Identifier: Apache-2.0
"""Between the card and the messages: scaling, watchdog, unloading."""
