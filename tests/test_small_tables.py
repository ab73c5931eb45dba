"""Small tables of labels and numbers."""

import numpy as np
import pytest

from data_tools.files.csv_table import read_columns
from evcalib.errors import InputError


def test_labels_stay_text_and_gaps_become_nan(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text('drive,error,shown\n"sweep, rough",1.5,1\nfingers,,0\n')
    table = read_columns(path)
    assert table["drive"].tolist() == ["sweep, rough", "fingers"]
    np.testing.assert_array_equal(table["error"], [1.5, np.nan])
    np.testing.assert_array_equal(table["shown"], [1.0, 0.0])


def test_a_row_that_does_not_fit_is_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("a,b\n1,2\n3\n")
    with pytest.raises(InputError, match="line 3"):
        read_columns(path)
