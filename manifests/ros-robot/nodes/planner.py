"""Plans a way over a map for each message of the camera, and publishes it with the message's stamp."""

import heapq

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import CameraInfo

SIZE = 60
WALLS = {(x, y) for x in range(6, SIZE, 6) for y in range(SIZE) if (y - x) % 29}
START, GOAL = (0, 0), (SIZE - 1, SIZE - 1)


def shortest_way() -> "list[tuple[int, int]]":
    """Return the shortest way from the start to the goal (Dijkstra)."""
    came_from, costs, queue = {START: START}, {START: 0}, [(0, START)]
    while queue:
        cost, (x, y) = heapq.heappop(queue)
        for place in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            is_free = 0 <= place[0] < SIZE and 0 <= place[1] < SIZE and place not in WALLS
            if is_free and cost + 1 < costs.get(place, SIZE * SIZE):
                costs[place], came_from[place] = cost + 1, (x, y)
                heapq.heappush(queue, (cost + 1, place))
    way, place = [], GOAL
    while place != came_from.get(place, START):
        way.append(place)
        place = came_from[place]
    return way


def main() -> None:
    """Answer until ROS ends this node."""
    rospy.init_node("planner")
    plans = rospy.Publisher("/plan", Path, queue_size=1)

    def plan(message: CameraInfo) -> None:
        way = Path(header=message.header)
        for x, y in shortest_way():
            pose = PoseStamped(header=message.header)
            pose.pose.position.x, pose.pose.position.y = x, y
            way.poses.append(pose)
        plans.publish(way)

    rospy.Subscriber("/camera/publisher/camera_info", CameraInfo, plan, queue_size=1, tcp_nodelay=True)
    rospy.spin()


if __name__ == "__main__":
    main()
