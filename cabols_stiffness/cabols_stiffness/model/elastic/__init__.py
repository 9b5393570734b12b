# SPDX-License-Identifier: Apache-2.0
"""An elastic arm beyond its joints' own stiffness: links, base, coupling, friction, variation."""
