"""From a bag to series, metrics and figures."""
