"""Bags written: what rosbags and the player of Jazzy read, whole or not at all."""

from __future__ import annotations

import pytest
import yaml
from recordings import ARM, START, STEP, TENDON_TENSIONS, TOPICS, random_tensions, samples

from octo_arm_model.arm.errors import BagError
from octo_arm_model.bags.reader import BagReader
from octo_arm_model.bags.writer import STORAGES, BagWriter


@pytest.mark.parametrize('storage', STORAGES)
def test_what_is_written_is_read(tmp_path, storage):
    content = [
        sample
        for topic, kind in TOPICS.items()
        for sample in samples(ARM, random_tensions(ARM, 40), topic, kind)
    ]
    content.sort(key=lambda sample: sample.received_ns)
    with BagWriter(tmp_path / 'bag', storage, {'arm': 'left'}) as writer:
        topics = {topic: writer.add(topic, kind) for topic, kind in TOPICS.items()}
        writer.write((topics[one.topic], one.received_ns, one.data) for one in content)
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.topics == TOPICS
        assert reader.metadata == {'arm': 'left'}
        assert reader.count() == 40 * len(TOPICS)
        assert reader.count(['/tendon_tensions']) == 40
        assert reader.start_ns == content[0].received_ns
        assert reader.duration == pytest.approx(39 * STEP * 1e-9)
        assert [tuple(record) for record in reader.messages()] == [tuple(one) for one in content]


def test_a_bag_has_what_the_player_of_jazzy_looks_for(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write([(writer.add('/arm_description', 'std_msgs/msg/String', True), START, b'')])
        writer.write([(writer.add('/backbone/path', 'nav_msgs/msg/Path'), START, b'')])
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['bag_0.mcap']
    assert (tmp_path / 'bag' / 'bag_0.mcap').is_file()
    latched, path = (one['topic_metadata'] for one in information['topics_with_message_count'])
    assert latched['type_description_hash'].startswith('RIHS01_')
    assert latched['serialization_format'] == 'cdr'
    (qos,) = latched['offered_qos_profiles']
    assert (qos['durability'], qos['reliability']) == ('transient_local', 'reliable')
    assert (qos['history'], qos['depth']) == ('keep_last', 1)
    (qos,) = path['offered_qos_profiles']
    assert (qos['durability'], qos['reliability']) == ('volatile', 'reliable')


@pytest.mark.parametrize('storage', STORAGES)
@pytest.mark.parametrize('error', [KeyboardInterrupt, MemoryError, ValueError])
def test_an_interrupted_bag_is_not_there(tmp_path, storage, error):
    with pytest.raises(error):
        with BagWriter(tmp_path / 'bag', storage) as writer:
            topic = writer.add('/tendon_tensions', TENDON_TENSIONS)
            writer.write([(topic, START, b'1234') for _ in range(1000)])
            assert not (tmp_path / 'bag').exists()
            raise error
    assert list(tmp_path.iterdir()) == []


def test_a_bag_does_not_replace_anything(tmp_path):
    (tmp_path / 'file').write_text('precious')
    (tmp_path / 'folder').mkdir()
    for name in ('file', 'folder'):
        with pytest.raises(BagError, match=f'{name}: exists already'):
            BagWriter(tmp_path / name)
    with pytest.raises(BagError, match='cannot be written: No such file or directory'):
        BagWriter(tmp_path / 'nowhere' / 'bag')
    with pytest.raises(BagError, match="storage is 'paper', expected one of mcap, sqlite3"):
        BagWriter(tmp_path / 'bag', 'paper')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['file', 'folder']
    assert (tmp_path / 'file').read_text() == 'precious'
