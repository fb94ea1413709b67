"""Every study at its small budget, with the simulators themselves: it ends, and is told again from its own folder."""

import pytest

from optim.studies.catalogue import STUDIES

pytestmark = pytest.mark.slow  # an hour of a core in all


@pytest.mark.kernels
@pytest.mark.parametrize("name", STUDIES)
def test_a_study_ends_and_its_folder_tells_the_same(morpholab, tmp_path, name):
    code, _, error = morpholab(f"reproduce {name} --budget small --quiet --out found")
    assert (code, error) == (0, "")
    study, found = STUDIES[name], tmp_path / "found"
    assert [file for file in study.writes if not (found / file).exists()] == []
    if study.rewrite is None:
        return
    assert morpholab(f"reproduce {name} --from-data found --quiet --out told")[0] == 0
    told = {path.name: path.read_bytes() for path in (tmp_path / "told").iterdir() if path.suffix in (".md", ".json")}
    assert told == {file: (found / file).read_bytes() for file in told}
