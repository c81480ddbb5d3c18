// A tracker and the driver of two arms over Fast-DDS, the default of most ROS 2 laboratories.
//
// fastdds SECONDS: for this time, sends points on /marble/position at 60 Hz and joint states at 100 Hz; the arms follow
// /left|right/joint_trajectory. At the end it prints a line for each arm: the number of received trajectories, and the
// smallest and the largest commanded position.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

constexpr size_t LARGEST = 4096;

// A message as its bytes, behind the four that say how they are encoded.
struct Bytes {
    std::vector<char> data = std::vector<char>(LARGEST);
    size_t size = 0;
};

class Type : public TopicDataType {
public:
    explicit Type(const std::string& name) {
        setName(name.c_str());
        m_typeSize = LARGEST;
        m_isGetKeyDefined = false;
        auto_fill_type_object(false);
        auto_fill_type_information(false);
    }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        const auto* bytes = static_cast<Bytes*>(data);
        payload->encapsulation = CDR_LE;
        payload->length = static_cast<uint32_t>(bytes->size);
        std::copy_n(bytes->data.begin(), bytes->size, payload->data);
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        auto* bytes = static_cast<Bytes*>(data);
        bytes->size = std::min<size_t>(payload->length, LARGEST);
        std::copy_n(payload->data, bytes->size, bytes->data.begin());
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
        return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size); };
    }
    void* createData() override { return new Bytes; }
    void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

double seconds_now() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

template <typename Fill>
void send(DataWriter* writer, Fill fill) {
    Bytes bytes;
    eprosima::fastcdr::FastBuffer buffer(bytes.data.data(), LARGEST);
    Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
    cdr.serialize_encapsulation();
    const double now = seconds_now();
    const double whole = std::floor(now);
    cdr << static_cast<int32_t>(whole) << static_cast<uint32_t>(1e9 * (now - whole)) << std::string("board");
    fill(cdr);
    bytes.size = cdr.getSerializedDataLength();
    writer->write(&bytes);
}

struct Arm {
    std::string joint;
    DataWriter* states;
    DataReader* commands;
    double angle = 0.0, least = 0.0, largest = 0.0;
    int heard = 0;

    void hear() {
        Bytes bytes;
        SampleInfo info;
        while (commands->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
            if (!info.valid_data) continue;
            eprosima::fastcdr::FastBuffer buffer(bytes.data.data(), bytes.size);
            Cdr cdr(buffer, Cdr::LITTLE_ENDIANNESS, Cdr::DDS_CDR);
            cdr.read_encapsulation();
            int32_t sec = 0;
            uint32_t nanosec = 0, points = 0;
            std::string frame;
            std::vector<std::string> names;
            std::vector<double> positions;
            cdr >> sec >> nanosec >> frame >> names >> points >> positions;
            if (names != std::vector<std::string>{joint} || points == 0 || positions.size() != 1) std::exit(3);
            angle = positions[0];
            least = std::min(least, angle);
            largest = std::max(largest, angle);
            ++heard;
        }
    }
    void report() {
        send(states, [this](Cdr& cdr) {
            const std::vector<double> none{0.0};
            cdr << std::vector<std::string>{joint} << std::vector<double>{angle} << none << none;
        });
    }
};

int main(int count, char** words) {
    if (count != 2) return 2;
    DomainParticipantQos quality;
    quality.transport().use_builtin_transports = false;
    auto loopback = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    loopback->interfaceWhiteList.push_back("127.0.0.1");
    quality.transport().user_transports.push_back(loopback);
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(0, quality);
    auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
    auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
    const auto topic = [&](const std::string& name, const std::string& type) {
        TypeSupport(new Type(type)).register_type(participant);
        return participant->create_topic("rt" + name, type, TOPIC_QOS_DEFAULT);
    };
    const auto writer = [&](Topic* on) {
        DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
        qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
        return publisher->create_datawriter(on, qos);
    };
    const auto reader = [&](Topic* on) {
        DataReaderQos qos = DATAREADER_QOS_DEFAULT;
        qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
        qos.history().kind = KEEP_ALL_HISTORY_QOS;
        return subscriber->create_datareader(on, qos);
    };
    const std::string states = "sensor_msgs::msg::dds_::JointState_";
    const std::string commands = "trajectory_msgs::msg::dds_::JointTrajectory_";
    auto* marble = writer(topic("/marble/position", "geometry_msgs::msg::dds_::PointStamped_"));
    std::vector<Arm> arms;
    for (const std::string side : {"left", "right"}) {
        arms.push_back({side + "_wrist", writer(topic("/" + side + "/joint_states", states)),
                        reader(topic("/" + side + "/joint_trajectory", commands))});
    }
    const auto begun = std::chrono::steady_clock::now();
    const int ticks = static_cast<int>(100.0 * std::atof(words[1]));
    for (int i = 0; i < ticks; ++i) {
        std::this_thread::sleep_until(begun + std::chrono::milliseconds(10 * i));
        for (auto& arm : arms) {
            arm.hear();
            arm.report();
        }
        if (i % 5 < 3) {
            send(marble, [i](Cdr& cdr) { cdr << 0.05 * std::sin(0.01 * i) << 1e-4 * std::sin(1e4 * i) << 0.0; });
        }
    }
    for (const auto& arm : arms) {
        std::cout << arm.joint << ' ' << arm.heard << ' ' << arm.least << ' ' << arm.largest << '\n';
    }
    return 0;
}
