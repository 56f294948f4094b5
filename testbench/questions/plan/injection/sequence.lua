--[[
Flies the sequence above on an ArduPilot Plane. Safe unless all of this holds: SCR_USER1 is the number of the card, the
start switch (RCn_OPTION = SWITCH_OPTION) has been seen low and is moved high, the aircraft is armed and in flight mode
MODE, with radio contact, at the card's airspeed and with little bank. Then the surfaces are held at the outputs they
have at that moment, for SETTLE_MS, and the sequence is added to them.

It stops, and the outputs return to the autopilot within TIMEOUT_MS, when the switch leaves high, the mode changes, radio
or airspeed are lost, the aircraft is disarmed, or airspeed, height, bank or pitch leave their limits. The next run
takes switching low and high again. What is commanded is logged as TBSQ.

Before the first flight: with the propeller off, in MODE, play each card on the ground (set SPEED_WINDOW to 100 for it)
and see that a positive elevator moves the trailing edge down, a positive aileron the right one up, a positive rudder
the trailing edge left, and that the deflections are those of the card.
]]

local TIMEOUT_MS = 3 * PERIOD_MS
local IDLE, READY, RUNNING, SPENT = 0, 1, 2, 3
local INFO, WARNING = 6, 4

local state = IDLE
local outputs = {}   -- one per servo: channel (from 0), captured, per_degree, low, high, column
local started        -- millis() at which surfaces were captured
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

local function switch_is_high()
  local channel = rc:find_channel_for_option(SWITCH_OPTION)
  return channel ~= nil and channel:get_aux_switch_pos() == 2
end

-- what keeps a run from starting or going on, whatever the state; nil if nothing does
local function not_fit()
  if param:get('SCR_USER1') ~= CARD then return 'SCR_USER1 is not this card' end
  if not arming:is_armed() then return 'disarmed' end
  if vehicle:get_mode() ~= MODE then return 'wrong flight mode' end
  if not rc:has_valid_input() then return 'no radio contact' end
  if not true_airspeed() then return 'no airspeed' end
  return nil
end

local function limit_met()
  local speed, climb = true_airspeed(), height() - start_height
  local roll, pitch = math.deg(roll_rad()), math.deg(pitch_rad())
  -- written so that what is not a number counts as outside
  if not (speed >= SPEED_LOW and speed <= SPEED_HIGH) then return 'airspeed limit' end
  if not (climb >= CLIMB_LOW and climb <= CLIMB_HIGH) then return 'height limit' end
  if not (roll >= BANK_DEG_LOW and roll <= BANK_DEG_HIGH) then return 'bank limit' end
  if not (pitch >= PITCH_DEG_LOW and pitch <= PITCH_DEG_HIGH) then return 'pitch limit' end
  return nil
end

local function output_now(channel, fn, several)
  local ok, pwm = pcall(function() return SRV_Channels:get_output_pwm_chan(channel) end)
  if ok then return pwm end
  if several then return nil end -- older firmware tells the output of a function, not of one of its channels
  return SRV_Channels:get_output_pwm(fn)
end

-- read every servo of the surfaces and capture its output; the reason if that cannot be, or if there is no room
local function capture()
  outputs = {}
  for _, surface in ipairs(SURFACES) do
    local numbers = {}
    for n = 1, 16 do
      if param:get('SERVO' .. n .. '_FUNCTION') == surface.fn then numbers[#numbers + 1] = n end
    end
    if #numbers == 0 then return 'no servo output for the ' .. surface.name end
    local least, most = 0, 0
    for _, degrees in ipairs(D[surface.column]) do
      least, most = math.min(least, degrees), math.max(most, degrees)
    end
    for _, n in ipairs(numbers) do
      local low, high = param:get('SERVO' .. n .. '_MIN'), param:get('SERVO' .. n .. '_MAX')
      local reversed = param:get('SERVO' .. n .. '_REVERSED')
      local pwm = output_now(n - 1, surface.fn, #numbers > 1)
      if not (low and high and reversed and pwm) then return 'cannot read the ' .. surface.name end
      local per_degree = surface.sign * (reversed == 1 and -1 or 1) * 0.5 * (high - low) / surface.full_deg
      local a, b = pwm + per_degree * least, pwm + per_degree * most
      if math.min(a, b) < low - 0.5 or math.max(a, b) > high + 0.5 then
        return 'no room for the ' .. surface.name .. ' at this trim'
      end
      outputs[#outputs + 1] = {
        channel = n - 1, captured = pwm, per_degree = per_degree, column = surface.column,
      }
    end
  end
  return nil
end

local function start()
  local reason = not_fit()
  if not reason and math.abs(true_airspeed() - SPEED) > SPEED_WINDOW then reason = 'not at the speed of the card' end
  if not reason and math.abs(math.deg(roll_rad())) > START_BANK_DEG then reason = 'too much bank' end
  reason = reason or capture()
  if reason then
    state = SPENT
    say(WARNING, 'not started, ' .. reason)
    return
  end
  started, start_height, row, state = millis(), height(), 1, RUNNING
  say(INFO, 'running')
end

local function stop(level, text)
  state, outputs = SPENT, {} -- nothing is commanded any more: the last overrides lapse
  say(level, text)
end

local function run()
  local reason = (not switch_is_high() and 'switch') or not_fit() or limit_met()
  if reason then
    stop(WARNING, 'ABORTED, ' .. reason)
    return
  end
  local t = (millis() - started):tofloat() - SETTLE_MS
  if t >= DURATION_MS then
    stop(INFO, 'done')
    return
  end
  while row < #T and T[row + 1] <= t do row = row + 1 end
  local commanded, sent = { 0.0, 0.0, 0.0 }, { 0.0, 0.0, 0.0 }
  for _, output in ipairs(outputs) do
    local degrees = t >= 0 and D[output.column][row] or 0.0 -- a surface that only holds has no rows
    local pwm = math.floor(output.captured + output.per_degree * degrees + 0.5)
    SRV_Channels:set_output_pwm_chan_timeout(output.channel, pwm, TIMEOUT_MS)
    commanded[output.column], sent[output.column] = degrees, pwm
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
