"""What Fast DDS is told about memory before it starts."""

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

from octo_arm_model.ros.node.main import PROFILES, bound_memory


def test_fast_dds_takes_our_profiles_unless_it_is_set_up_otherwise(tmp_path):
    environment = {}
    assert bound_memory(environment, tmp_path)
    assert environment['RMW_FASTRTPS_USE_QOS_FROM_XML'] == '1'
    assert environment['FASTDDS_DEFAULT_PROFILES_FILE'] == str(PROFILES)
    assert '<historyMemoryPolicy>DYNAMIC<' in PROFILES.read_text(encoding='utf-8')
    # A child of such a process finds it done.
    before = dict(environment)
    assert not bound_memory(environment, tmp_path)
    assert environment == before


@pytest.mark.parametrize(
    'name',
    [
        'FASTDDS_DEFAULT_PROFILES_FILE',
        'FASTRTPS_DEFAULT_PROFILES_FILE',
        'RMW_FASTRTPS_USE_QOS_FROM_XML',
        'RMW_FASTRTPS_PUBLICATION_MODE',
    ],
)
def test_what_the_user_has_set_up_stays(name, tmp_path):
    environment = {name: 'mine'}
    assert not bound_memory(environment, tmp_path)
    assert environment == {name: 'mine'}


def test_a_profile_in_the_folder_stays(tmp_path):
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').write_text('<dds/>')
    environment = {}
    assert not bound_memory(environment, tmp_path)
    assert not environment
