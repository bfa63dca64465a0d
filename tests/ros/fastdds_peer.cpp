// A peer on Fast DDS, which is what rmw_fastrtps_cpp speaks, with the security that PyPI's builds of it lack.
//
//   fastdds_peer listen TOPIC TYPE [ENCLAVE]    prints every message that comes
//   fastdds_peer publish TOPIC TYPE [ENCLAVE]   publishes every message of stdin, 100 a second, to who listens within 20 s
//
// Names are those of DDS (rt/taxels, sensor_msgs::msg::dds_::LaserScan_). A message is a line: its CDR in hex, header
// included. ENCLAVE is a folder of an SROS2 keystore; without it everything is in the clear. The first line that is
// printed is `ready`; it goes on until it is killed, or stdin ends.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/log/StdoutErrConsumer.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

using Bytes = std::vector<unsigned char>;

// Messages of any type, as the bytes that they are.
class Raw : public TopicDataType {
public:
    explicit Raw(const char* name) {
        setName(name);
        m_typeSize = 65536;
        m_isGetKeyDefined = false;
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const Bytes& bytes = *static_cast<Bytes*>(data);
        if (bytes.size() < 4 || bytes.size() > payload->max_size) return false;
        std::memcpy(payload->data, bytes.data(), bytes.size());
        payload->length = bytes.size();
        payload->encapsulation = bytes[1] == 1 ? CDR_LE : CDR_BE;
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

// The properties that rmw_fastrtps_shared_cpp sets for an enclave.
void secure(DomainParticipantQos& qos, const std::string& folder) {
    auto add = [&](const std::string& name, const std::string& value) {
        qos.properties().properties().emplace_back("dds.sec." + name, value);
    };
    auto file = [&](const std::string& name) { return "file://" + folder + "/" + name; };
    add("auth.plugin", "builtin.PKI-DH");
    add("auth.builtin.PKI-DH.identity_ca", file("identity_ca.cert.pem"));
    add("auth.builtin.PKI-DH.identity_certificate", file("cert.pem"));
    add("auth.builtin.PKI-DH.private_key", file("key.pem"));
    add("crypto.plugin", "builtin.AES-GCM-GMAC");
    add("access.plugin", "builtin.Access-Permissions");
    add("access.builtin.Access-Permissions.permissions_ca", file("permissions_ca.cert.pem"));
    add("access.builtin.Access-Permissions.governance", file("governance.p7s"));
    add("access.builtin.Access-Permissions.permissions", file("permissions.p7s"));
}

template <class T>
T* made(T* entity, const char* what) {
    if (!entity) throw std::runtime_error(std::string("no ") + what);
    return entity;
}

void listen(DomainParticipant* participant, Topic* topic) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().kind = KEEP_ALL_HISTORY_QOS;
    auto* reader = made(made(participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT), "subscriber")->create_datareader(topic, qos), "reader");
    std::cout << "ready" << std::endl;
    for (;;) {
        reader->wait_for_unread_message({1, 0});
        Bytes bytes;
        SampleInfo info;
        while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            for (unsigned char byte : bytes) std::printf("%02x", byte);
            std::printf("\n");
            std::fflush(stdout);
        }
    }
}

void publish(DomainParticipant* participant, Topic* topic) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().kind = KEEP_ALL_HISTORY_QOS;
    auto* writer = made(made(participant->create_publisher(PUBLISHER_QOS_DEFAULT), "publisher")->create_datawriter(topic, qos), "writer");
    std::cout << "ready" << std::endl;
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    PublicationMatchedStatus matched;
    while (writer->get_publication_matched_status(matched), matched.current_count == 0) {
        if (std::chrono::steady_clock::now() > deadline) throw std::runtime_error("nobody listens");
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    for (std::string line; std::getline(std::cin, line);) {
        Bytes bytes;
        for (size_t at = 0; at + 1 < line.size(); at += 2) bytes.push_back(std::stoi(line.substr(at, 2), nullptr, 16));
        writer->write(&bytes);
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
}

int main(int argc, char** argv) try {
    if (argc < 4) throw std::runtime_error("fastdds_peer listen|publish TOPIC TYPE [ENCLAVE]");
    Log::ClearConsumers(); // stdout is for messages
    Log::RegisterConsumer(std::make_unique<StdoutErrConsumer>());
    DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
    if (argc > 4) secure(qos, argv[4]);
    auto* participant = made(DomainParticipantFactory::get_instance()->create_participant(0, qos), "participant");
    TypeSupport type(new Raw(argv[3]));
    type.register_type(participant);
    auto* topic = made(participant->create_topic(argv[2], argv[3], TOPIC_QOS_DEFAULT), "topic");
    std::string(argv[1]) == "listen" ? listen(participant, topic) : publish(participant, topic);
    std::cout.flush();
    std::_Exit(0); // nothing to tell the others: they are not asked about leaving
} catch (const std::exception& error) {
    std::cerr << "fastdds_peer: " << error.what() << std::endl;
    return 1;
}
