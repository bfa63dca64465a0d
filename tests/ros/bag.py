"""The taxels and joint angles of a bag, in its order, decoded by readers that are not ours."""
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def samples(path, taxels, joints):
    """Yields (topic, log time in ns, message) of these two topics."""
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=[taxels, joints]):
            yield channel.topic, message.log_time, decoded
