# SPDX-License-Identifier: Apache-2.0
"""A topic that was read into memory as a pandas.DataFrame."""

from __future__ import annotations

from typing import Any

from cabols_control.bags.reader import LOG_TIME, PUBLISH_TIME, Series
from cabols_control.export.table import Table
from cabols_control.export.writers import flat_names, flat_values, library


def to_pandas(series: Series) -> Any:
    """Return a DataFrame; its index `time_s` counts from the bag's first stamp [s].

    Without a header the index is the time of recording, from the topic's first message.

    Args:
        series: of a topic, from read_bag.
    """
    pandas = library("pandas", "sudo apt install python3-pandas, or pip install pandas")
    columns = {
        LOG_TIME: series.log_time_ns,
        PUBLISH_TIME: series.publish_time_ns,
        **{field: series[field] for field in series.fields},
    }
    table = Table(series.topic, series.type_name)
    table.learn(columns)
    shapes = table.columns()
    names, values = flat_names(shapes), flat_values(shapes, table.values(columns))
    time = series.stamp if table.stamped else 1e-9 * (series.log_time_ns - series.log_time_ns[0])
    index = pandas.Index(time, name="time_s")
    return pandas.DataFrame(dict(zip(names, values, strict=True)), index=index)
