--[[
Flies the sequence above on an ArduPilot Plane. Safe unless all of this holds: SCR_USER1 is the number of the card, the
start switch (RCn_OPTION = SWITCH_OPTION) has been seen low and is moved high, the aircraft is armed and in flight mode
MODE, with radio contact, at the card's airspeed and with little bank. Then the servos of the surfaces above are held at
the outputs they have at that moment, for SETTLE_MS, and the sequence is added to them. A servo is found by its
SERVOn_FUNCTION: elevator 19, aileron 4, rudder 21, flaperons 24 and 25, elevons 77 and 78, V-tail 79 and 80; a pulse is
reckoned from SERVOn_MIN, _TRIM, _MAX and _REVERSED as the autopilot reckons it.

It stops, and the outputs return to the autopilot within TIMEOUT_MS, when the switch leaves high, the pilot moves the
stick of roll, pitch or yaw (RCMAP_) by more than STICK_US, the mode changes, as by a geofence, or a fence is breached,
radio or airspeed are lost, the aircraft is disarmed, a quantity of LIMITS leaves its limits or is not a number, or when
the autopilot calls the script so late that its outputs have lapsed. The next run takes switching low and high again.
What is commanded is logged as TBSQ, what ended a run as TBSE. All scripts on the card share the memory of SCR_HEAP_SIZE:
copy those that are flown next. The accelerometer's load factor is that behind INS_ACCEL_FILTER; angle of attack is
reckoned from load factor and airspeed by the lift curve of the card.

Before the first flight: with the propeller off, in MODE, play each card on the ground (set SPEED_WINDOW to 100 and take
the airspeed out of LIMITS for it) and see that a positive elevator moves the trailing edge down, a positive aileron the
right one up, a positive rudder the trailing edge left, and that the deflections are those of the card.
]]

local TIMEOUT_MS = 3 * PERIOD_MS
local IDLE, READY, RUNNING, SPENT = 0, 1, 2, 3
local INFO, WARNING = 6, 4
local G0 = 9.80665

-- SERVOn_FUNCTION -> what the demands of elevator, aileron and rudder (1 is full throw: nose up, right, right) move it
local PARTS = {
  [19] = { 1, 0, 0 }, [4] = { 0, 1, 0 }, [21] = { 0, 0, 1 }, [24] = { 0, 1, 0 }, [25] = { 0, 1, 0 },
  [77] = { 1, -1, 0 }, [78] = { 1, 1, 0 }, [79] = { 1, 0, 1 }, [80] = { 1, 0, -1 },
}
local SPLIT = { [16] = true, [17] = true, [86] = true, [87] = true } -- split elevons: drag and moment are not told apart

local state = IDLE
local outputs = {}   -- one per servo: channel (from 0), share (of full throw, captured), its ends, parts and bases
local sticks         -- pulses of the pilot's sticks at the start
local started        -- millis() at which surfaces were captured
local last           -- millis() of the frame before
local start_height
local row = 1

local function say(level, text)
  gcs:send_text(level, string.format('TB card %d: %s', CARD, text))
end

-- older firmware has other names for the same value; the first that works is kept
local function first_of(candidates)
  for _, candidate in ipairs(candidates) do
    if pcall(candidate) then
      return candidate
    end
  end
  return candidates[#candidates]
end

local roll_rad = first_of({
  function() return ahrs:get_roll_rad() end,
  function() return ahrs:get_roll() end,
})
local pitch_rad = first_of({
  function() return ahrs:get_pitch_rad() end,
  function() return ahrs:get_pitch() end,
})

local function true_airspeed()
  local speed = ahrs:airspeed_estimate()
  return speed and speed * ahrs:get_EAS2TAS()
end

local function height()
  return -ahrs:get_relative_position_D_home()
end

local function load_factor()
  return -ahrs:get_accel():z() / G0
end

-- lift is linear: n = (V / SPEED)^2 (TRIM_LOAD + LOAD_PER_DEG (alpha - TRIM_ALPHA_DEG))
local function alpha_deg()
  local slow = SPEED / true_airspeed()
  return TRIM_ALPHA_DEG + (load_factor() * slow * slow - TRIM_LOAD) / LOAD_PER_DEG
end

local WATCHED = {
  { 'airspeed', true_airspeed },
  { 'height', function() return height() - start_height end },
  { 'bank', function() return math.deg(roll_rad()) end },
  { 'pitch', function() return math.deg(pitch_rad()) end },
  { 'load factor', load_factor },
  { 'alpha', alpha_deg },
}

local function switch_is_high()
  local channel = rc:find_channel_for_option(SWITCH_OPTION)
  return channel ~= nil and channel:get_aux_switch_pos() == 2
end

-- pulses of roll, pitch and yaw as the pilot holds them; nil where one is not to be read
local function sticks_now()
  local pulses = {}
  for i, name in ipairs({ 'RCMAP_ROLL', 'RCMAP_PITCH', 'RCMAP_YAW' }) do
    local channel = param:get(name)
    local pulse = channel and rc:get_pwm(math.floor(channel))
    if not pulse then return nil end
    pulses[i] = pulse
  end
  return pulses
end

local function stick_moved()
  local now = sticks_now()
  if not now then return 'sticks cannot be read' end
  for i, pulse in ipairs(now) do
    if not (math.abs(pulse - sticks[i]) <= STICK_US) then return 'the pilot took the stick' end
  end
  return nil
end

-- older firmware tells no breach; its fence changes the flight mode, which ends a run as well
local function fence_breached()
  local ok, breaches = pcall(function() return fence:get_breaches() end)
  return ok and breaches ~= 0
end

-- what keeps a run from starting or going on, whatever the state; nil if nothing does
local function not_fit()
  if param:get('SCR_USER1') ~= CARD then return 'SCR_USER1 is not this card' end
  if not arming:is_armed() then return 'disarmed' end
  if vehicle:get_mode() ~= MODE then return 'wrong flight mode' end
  if not rc:has_valid_input() then return 'no radio contact' end
  if not true_airspeed() then return 'no airspeed' end
  if fence_breached() then return 'geofence' end
  return nil
end

local function limit_met()
  for _, watched in ipairs(WATCHED) do
    local limit = LIMITS[watched[1]]
    if limit then
      local value = watched[2]()
      -- written so that what is not a number counts as outside
      if not (value >= limit[1] and value <= limit[2]) then return watched[1] .. ' limit' end
    end
  end
  return nil
end

local function output_now(channel, fn, several)
  local ok, pwm = pcall(function() return SRV_Channels:get_output_pwm_chan(channel) end)
  if ok then return pwm end
  if several then return nil end -- older firmware tells the output of a function, not of one of its channels
  return SRV_Channels:get_output_pwm(fn)
end

-- demand, -1 to 1, of a deflection in the card's sign, and back; a surface may move less far to one side
local function demand_of(surface, degrees)
  return surface.sign * degrees / (degrees >= 0 and surface.full_deg or surface.least_deg)
end

local function degrees_of(surface, demand)
  local part = surface.sign * demand
  return part * (part >= 0 and surface.full_deg or surface.least_deg)
end

local function share_of(output, pwm)
  local off = pwm - output.trim
  local share = off / (off >= 0 and output.high - output.trim or output.trim - output.low)
  return output.turned and -share or share
end

-- pulse of an output at deflections from trim, one per surface of SURFACES
local function pulse(output, degrees)
  local share = output.share
  for i, surface in ipairs(SURFACES) do
    local part = output.parts[surface.column]
    if part ~= 0 and degrees[i] ~= 0 then
      local base = output.bases[i]
      share = share + part * (demand_of(surface, base + degrees[i]) - demand_of(surface, base))
    end
  end
  if output.turned then share = -share end
  return output.trim + share * (share >= 0 and output.high - output.trim or output.trim - output.low)
end

local function name_of(parts)
  for _, surface in ipairs(SURFACES) do
    if parts[surface.column] ~= 0 then return surface.name end
  end
  return nil
end

-- find every servo of the surfaces and capture its output; the reason if that cannot be, or if there is no room
local function capture()
  outputs = {}
  local found, count = {}, {}
  for n = 1, 32 do
    local fn = param:get('SERVO' .. n .. '_FUNCTION')
    if fn and SPLIT[fn] then return 'split elevons are not for this script' end
    if fn and PARTS[fn] and name_of(PARTS[fn]) then
      found[#found + 1] = { n, fn }
      count[fn] = (count[fn] or 0) + 1
    end
  end
  local driven = {}
  for _, servo in ipairs(found) do
    local n, fn = servo[1], servo[2]
    local key = 'SERVO' .. n
    local reversed = param:get(key .. '_REVERSED')
    local output = {
      channel = n - 1, parts = PARTS[fn], bases = {}, turned = reversed == 1,
      low = param:get(key .. '_MIN'), trim = param:get(key .. '_TRIM'), high = param:get(key .. '_MAX'),
    }
    local name = name_of(PARTS[fn])
    local pwm = output_now(n - 1, fn, count[fn] > 1)
    if not (output.low and output.trim and output.high and reversed and pwm) then return 'cannot read the ' .. name end
    if not (output.low < output.trim and output.trim < output.high) then
      return 'SERVO' .. n .. '_TRIM is not between its ends'
    end
    output.share = share_of(output, pwm)
    local mixed = 0
    for _, part in ipairs(output.parts) do mixed = mixed + math.abs(part) end
    for i, surface in ipairs(SURFACES) do
      local part = output.parts[surface.column]
      if part ~= 0 then driven[i] = true end
      -- a mixed servo does not tell which of its surfaces the trim is of
      output.bases[i] = (mixed == 1 and part ~= 0) and degrees_of(surface, output.share * part) or 0.0
    end
    for i, surface in ipairs(SURFACES) do
      for _, degrees in ipairs({ surface.lowest, surface.highest }) do
        local at = {}
        for j = 1, #SURFACES do at[j] = j == i and degrees or 0.0 end
        local moved = pulse(output, at)
        if moved < output.low - 0.5 or moved > output.high + 0.5 then return 'no room for the ' .. name .. ' at this trim' end
      end
    end
    outputs[#outputs + 1] = output
  end
  for i, surface in ipairs(SURFACES) do
    if surface.moved and not driven[i] then return 'no servo output for the ' .. surface.name end
  end
  return nil
end

local function start()
  local reason = not_fit()
  if not reason and not (math.abs(true_airspeed() - SPEED) <= SPEED_WINDOW) then reason = 'not at the speed of the card' end
  if not reason and not (math.abs(math.deg(roll_rad())) <= START_BANK_DEG) then reason = 'too much bank' end
  sticks = sticks_now()
  reason = reason or (not sticks and 'sticks cannot be read') or capture()
  if reason then
    state = SPENT
    say(WARNING, 'not started, ' .. reason)
    return
  end
  started, start_height, row, state = millis(), height(), 1, RUNNING
  last = started
  say(INFO, 'running')
end

local function stop(level, text)
  state, outputs = SPENT, {} -- nothing is commanded any more: the last overrides lapse
  say(level, text)
  local seconds = started and 0.001 * (millis() - started):tofloat() or 0.0
  pcall(function() logger:write('TBSE', 'Card,T,Why', 'ffZ', CARD, seconds, text:sub(1, 63)) end)
end

local function run()
  local now = millis()
  local late = (now - last):tofloat() > TIMEOUT_MS
  last = now
  local reason = (not switch_is_high() and 'switch') or not_fit() or stick_moved() or limit_met() or (late and 'scripting is too slow') or nil
  if reason then
    stop(WARNING, 'ABORTED, ' .. reason)
    return
  end
  local t = (now - started):tofloat() - SETTLE_MS
  if t >= DURATION_MS then
    stop(INFO, 'done')
    return
  end
  while row < #T and T[row + 1] <= t do row = row + 1 end
  local commanded, sent, degrees = { 0.0, 0.0, 0.0 }, { 0.0, 0.0, 0.0 }, {}
  for i, surface in ipairs(SURFACES) do
    degrees[i] = t >= 0 and D[surface.column][row] or 0.0 -- a surface that only holds has no rows
    commanded[surface.column] = degrees[i]
  end
  for _, output in ipairs(outputs) do
    local pwm = math.floor(pulse(output, degrees) + 0.5)
    SRV_Channels:set_output_pwm_chan_timeout(output.channel, pwm, TIMEOUT_MS)
    for _, surface in ipairs(SURFACES) do
      if output.parts[surface.column] ~= 0 then sent[surface.column] = pwm end
    end
  end
  logger:write('TBSQ', 'Card,T,de,da,dr,PE,PA,PR', 'ffffffff', CARD, 0.001 * t,
    commanded[1], commanded[2], commanded[3], sent[1], sent[2], sent[3])
end

local function tick()
  if state == RUNNING then
    run()
  elseif param:get('SCR_USER1') ~= CARD then
    state = IDLE -- another card is chosen, or none: not a word
  elseif not switch_is_high() then
    state = READY
  elseif state == READY then
    start()
    if state == RUNNING then run() end
  end
end

local function update()
  local ok, message = pcall(tick)
  if not ok then
    stop(WARNING, 'ABORTED, ' .. tostring(message))
  end
  return update, PERIOD_MS
end

say(INFO, 'loaded, waits for SCR_USER1 and the switch')
return update()
